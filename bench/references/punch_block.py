"""3D P2 (P2-P1 lumped-free Taylor-Hood for nu>=.45) quarter model of the bonded circular punch on the 2 m block (bottom, sides clamped or sides free)."""
import numpy as np, scipy.sparse as sp, gmsh, sys, subprocess, os
def mesh(a,L,hr,g,hmax):
    gmsh.initialize(); gmsh.option.setNumber('General.Terminal',0)
    o=gmsh.model.occ
    b=o.addBox(0,0,-2*L,L,L,2*L); d=o.addDisk(0,0,0,a,a)
    out,mp=o.fragment([(3,b)],[(2,d)]); o.synchronize()
    # drop surfaces outside the volume
    vols=gmsh.model.getEntities(3); keep={abs(t) for _,t in gmsh.model.getBoundary(vols,oriented=False)}
    ex=[(2,t) for _,t in gmsh.model.getEntities(2) if t not in keep]
    gmsh.model.removeEntities(ex,recursive=True) if ex else None
    s=gmsh.option.setNumber
    s('Mesh.MeshSizeExtendFromBoundary',0);s('Mesh.MeshSizeFromPoints',0);s('Mesh.MeshSizeMax',10);s('Mesh.MeshSizeFromCurvature',0)
    gmsh.model.mesh.setSizeCallback(lambda d,t,x,y,z,lc=0:min(hmax,hr+g*np.hypot(np.hypot(x,y)-a,z)))
    gmsh.model.mesh.generate(3); gmsh.model.mesh.setOrder(2)
    tags,xyz,_=gmsh.model.mesh.getNodes(); X=xyz.reshape(-1,3); idx=np.zeros(int(tags.max())+1,int); idx[tags.astype(int)]=np.arange(len(tags))
    et,_,en=gmsh.model.mesh.getElements(3); T=idx[en[0].astype(int)].reshape(-1,10); T=T[:,[0,1,2,3,4,5,6,7,9,8]]  # gmsh: last two swapped -> edges 01 12 20 03 13 23
    gmsh.finalize()
    u=np.unique(T); m=-np.ones(len(X),int); m[u]=np.arange(len(u)); return X[u],m[T]
pr=[(0,1),(1,2),(2,0),(0,3),(1,3),(2,3)]
def assemble(X,T,nu,mixed):
    nt=len(T);N=len(X);mu=.5/(1+nu);kap=1/(3*(1-2*nu));lam=kap-2*mu/3
    QA,QB=(5+3*5**.5)/20,(5-5**.5)/20
    dl=np.zeros((4,3)); dl[1:]=np.eye(3); dl[0]=-1
    Ke=np.zeros((nt,30,30)); Be=np.zeros((nt,4,30));Me=np.zeros((nt,4,4))
    for q in range(4):
        L=np.full(4,QB);L[q]=QA
        dN=np.zeros((10,3))
        for i in range(4): dN[i]=(4*L[i]-1)*dl[i]
        for m,(i,j) in enumerate(pr): dN[4+m]=4*(L[i]*dl[j]+L[j]*dl[i])
        J=np.einsum('nr,tnx->trx',dN,X[T]); det=np.linalg.det(J); iv=np.linalg.inv(J); g=np.einsum('txr,nr->tnx',iv,dN)
        w=det/24
        gg=np.einsum('tax,tbx->tab',g,g)
        c=-2*mu/3 if mixed else lam
        blk=mu*np.einsum('taj,tbi->taibj',g,g)+c*np.einsum('tai,tbj->taibj',g,g)
        for i in range(3): blk[:,:,i,:,i]+=mu*gg
        Ke+=blk.reshape(nt,30,30)*w[:,None,None]
        if mixed: Be+=np.einsum('p,ti,t->tpi',L,g.reshape(nt,30),w); Me+=np.einsum('p,q,t->tpq',L,L,w)
    dof=(3*T[:,:,None]+np.arange(3)).reshape(nt,30)
    K=sp.csr_matrix((Ke.ravel(),(np.repeat(dof,30,1).ravel(),np.tile(dof,(1,30)).ravel())),shape=(3*N,3*N))
    if not mixed: return K,0
    vs,P=np.unique(T[:,:4],return_inverse=True);P=P.reshape(nt,4);nv=len(vs)
    B=sp.csr_matrix((Be.ravel(),(np.repeat(P,30,1).ravel(),np.tile(dof,(1,4)).ravel())),shape=(nv,3*N))
    M=sp.csr_matrix((Me.ravel(),(np.repeat(P,4,1).ravel(),np.tile(P,(1,4)).ravel())),shape=(nv,nv))
    return sp.bmat([[K,B.T],[B,-M/kap]]).tocsr(),nv
def run(X,T,a,L,nu,sides,kind,mixed):
    A,nv=assemble(X,T,nu,mixed); N=len(X); e=1e-9
    fix=np.zeros((N,3),bool); val=np.zeros((N,3))
    bot=X[:,2]<-2*L+e
    if sides: bot|=(X[:,0]>L-e)|(X[:,1]>L-e)
    fix[bot]=True
    cap=(X[:,2]>-e)&(np.hypot(X[:,0],X[:,1])<=a*(1+1e-6)); fix[cap]=True
    if kind=='axial': fix[X[:,0]<e,0]=True; fix[X[:,1]<e,1]=True; val[cap,2]=-1; comp=2
    else: fix[X[:,1]<e,1]=True; fix[X[:,0]<e,1]=True; fix[X[:,0]<e,2]=True; val[cap,0]=1; comp=0
    isf=np.concatenate([fix.ravel(),np.zeros(nv,bool)]); full=np.concatenate([val.ravel(),np.zeros(nv)])
    fr=np.where(~isf)[0]; S=A[fr][:,fr].tocsc(); S.sort_indices(); b=-(A[fr]@full)
    f='/tmp/ref/sys.bin'
    with open(f,'wb') as h:
        np.array([S.shape[0],S.nnz,0 if mixed else 1],np.int64).tofile(h); S.indptr.astype(np.int64).tofile(h); S.indices.astype(np.int64).tofile(h); S.data.tofile(h); b.tofile(h)
    subprocess.check_call(['/tmp/ref/spsolve',f]); full[fr]=np.fromfile(f+'.out')
    R=(A@full)[:3*N].reshape(N,3)
    return 4*R[cap,comp].sum(),cap.sum(),len(fr)
if __name__=='__main__':
    a=float(sys.argv[1]); hr=float(sys.argv[2]); g=float(sys.argv[3]); L=1.
    X,T=mesh(a,L,hr,g,.3); print(len(X),len(T),flush=True)
    for nu in [float(v) for v in sys.argv[4].split(',')]:
        for sides in (1,):
            for kind in ('axial','lateral'):
                F,nc,n=run(X,T,a,L,nu,sides,kind,nu>=.45); print(a,hr,g,nu,'sides' if sides else 'free',kind,F,'cap',nc,'n',n,flush=True)
