"""Axisymmetric (Fourier harmonic n = 0, 1) FE, curved P2 triangles, optional continuous-P1 pressure (Taylor-Hood)."""
import numpy as np, scipy.sparse as sp, scipy.sparse.linalg as sl, gmsh, json, sys
# 12-point degree 6 triangle rule
def trirule():
    a1,b1,w1=0.873821971016996,0.063089014491502,0.050844906370207
    a2,b2,w2=0.501426509658179,0.249286745170910,0.116786275726379
    p=[];w=[]
    for a,b,ww in((a1,b1,w1),(a2,b2,w2)):
        for q in((a,b,b),(b,a,b),(b,b,a)):p.append(q);w.append(ww)
    A,B,C,w3=0.636502499121399,0.310352451033785,0.053145049844816,0.082851075618374
    import itertools
    for q in itertools.permutations((A,B,C)):p.append(q);w.append(w3)
    return np.array(p),np.array(w)/2
def P2(L):
    l1,l2,l3=L
    N=np.array([l1*(2*l1-1),l2*(2*l2-1),l3*(2*l3-1),4*l1*l2,4*l2*l3,4*l3*l1])
    # derivs wrt xi=l2, eta=l3 (l1=1-xi-eta)
    dx=np.array([-(4*l1-1),4*l2-1,0,4*(l1-l2),4*l3,-4*l3])
    de=np.array([-(4*l1-1),0,4*l3-1,-4*l2,4*l2,4*(l1-l3)])
    return N,dx,de
def solve(X,T,nu,E,n,bc,mixed):
    """X (N,2) r,z ; T (nt,6); bc: list of (dof nodes, comp, value arrays) ; comp 0 r,1 z,2 theta. returns U (N,3), R reactions"""
    mu=E/2/(1+nu); lam=E*nu/(1+nu)/(1-2*nu); kap=lam+2*mu/3
    N=len(X); nt=len(T); pts,w=trirule()
    Xe=X[T]
    nd=18
    Ke=np.zeros((nt,nd,nd)); 
    if mixed: Be=np.zeros((nt,3,nd)); Me=np.zeros((nt,3,3))
    Ddev=mu*np.diag([2,2,2,1,1,1.]).astype(float)
    m=np.array([1,1,1,0,0,0.])
    D=Ddev+lam*np.outer(m,m)
    Dd=Ddev-2*mu/3*np.outer(m,m)
    for L,ww in zip(pts,w):
        Nn,dx,de=P2(L)
        J=np.stack([np.einsum('i,tij->tj',dx,Xe),np.einsum('i,tij->tj',de,Xe)],1) # (t,2(ref),2(phys))
        det=J[:,0,0]*J[:,1,1]-J[:,0,1]*J[:,1,0]
        inv=np.empty_like(J); inv[:,0,0]=J[:,1,1];inv[:,1,1]=J[:,0,0];inv[:,0,1]=-J[:,0,1];inv[:,1,0]=-J[:,1,0]; inv/=det[:,None,None]
        g=inv[:,:,0][:,:,None]*dx+inv[:,:,1][:,:,None]*de  # (t,2,6)
        r=Xe[:,:,0]@Nn
        B=np.zeros((nt,6,nd))
        B[:,0,0::3]=g[:,0]; B[:,1,1::3]=g[:,1]; B[:,2,0::3]=Nn/r[:,None]; B[:,2,2::3]=n*Nn/r[:,None]
        B[:,3,0::3]=g[:,1]; B[:,3,1::3]=g[:,0]
        B[:,4,2::3]=g[:,0]-Nn/r[:,None]; B[:,4,0::3]=-n*Nn/r[:,None]
        B[:,5,2::3]=g[:,1]; B[:,5,1::3]=-n*Nn/r[:,None]
        dV=ww*det*r
        Ke+=np.einsum('tai,ab,tbj,t->tij',B,Dd if mixed else D,B,dV,optimize=True)
        if mixed:
            div=B[:,0]+B[:,1]+B[:,2]
            Be+=np.einsum('p,ti,t->tpi',L,div,dV); Me+=np.einsum('p,q,t->tpq',L,L,dV)
    dof=(3*T[:,:,None]+np.arange(3)).reshape(nt,18)
    I=np.repeat(dof,18,1).ravel(); Jx=np.tile(dof,(1,18)).ravel()
    K=sp.csr_matrix((Ke.ravel(),(I,Jx)),shape=(3*N,3*N))
    nv=0
    if mixed:
        vs,inv_=np.unique(T[:,:3],return_inverse=True); nv=len(vs); P=inv_.reshape(nt,3)
        Bm=sp.csr_matrix((Be.ravel(),(np.repeat(P,18,1).ravel(),np.tile(dof,(1,3)).ravel())),shape=(nv,3*N))
        Mm=sp.csr_matrix((Me.ravel(),(np.repeat(P,3,1).ravel(),np.tile(P,(1,3)).ravel())),shape=(nv,nv))
        A=sp.bmat([[K,Bm.T],[Bm,-Mm/kap]]).tocsr()
    else: A=K
    # constraints
    val=np.zeros(3*N); isfix=np.zeros(3*N,bool)
    for nodes,c,v in bc:
        val[3*nodes+c]=v; isfix[3*nodes+c]=True
    ax=np.where(X[:,0]<1e-12)[0]
    if n==0:
        isfix[3*ax]=True; isfix[2::3]=True
        ties=[]
    else:
        isfix[3*ax+1]=True
        ties=[a for a in ax if not isfix[3*a+2]]
        for a in ax:
            if isfix[3*a+2]: assert abs(val[3*a]+val[3*a+2])<1e-15
    free=np.where(~np.concatenate([isfix,np.zeros(nv,bool)]))[0]
    tie=np.array(ties,int); 
    keep=np.setdiff1d(free,3*tie+2)
    pos=-np.ones(3*N+nv,int); pos[keep]=np.arange(len(keep))
    rows=list(keep)+list(3*tie+2); cols=list(pos[keep])+list(pos[3*tie]); vals=[1.]*len(keep)+[-1.]*len(tie)
    Q=sp.csr_matrix((vals,(rows,cols)),shape=(3*N+nv,len(keep)))
    full=np.concatenate([val,np.zeros(nv)])
    x=sl.splu((Q.T@A@Q).tocsc()).solve(-(Q.T@(A@full)))
    full=full+Q@x
    R=(A@full)[:3*N].reshape(N,3)
    fac=2*np.pi if n==0 else np.pi
    return full[:3*N].reshape(N,3),R*fac,float(full@(A@full))
def mesh2d(build,hfun):
    gmsh.initialize(); gmsh.option.setNumber('General.Terminal',0)
    g=gmsh.model.geo; build(g); g.synchronize()
    gmsh.option.setNumber('Mesh.MeshSizeExtendFromBoundary',0);gmsh.option.setNumber('Mesh.MeshSizeFromPoints',0)
    gmsh.option.setNumber('Mesh.MeshSizeMin',0); gmsh.option.setNumber('Mesh.MeshSizeMax',1e9)
    gmsh.option.setNumber('Mesh.Algorithm',6)
    gmsh.model.mesh.setSizeCallback(lambda d,t,x,y,z,lc=0:hfun(x,y))
    gmsh.model.mesh.generate(2); gmsh.model.mesh.setOrder(2)
    tags,xyz,_=gmsh.model.mesh.getNodes(); X=xyz.reshape(-1,3)[:,:2]
    _,_,el=gmsh.model.mesh.getElements(2); 
    idx=np.zeros(int(tags.max())+1,int); idx[tags.astype(int)]=np.arange(len(tags))
    T=idx[el[0].astype(int)].reshape(-1,6)
    gmsh.finalize()
    a=X[T]; d=(a[:,1]-a[:,0]); e=a[:,2]-a[:,0]
    s=d[:,0]*e[:,1]-d[:,1]*e[:,0]
    T[s<0]=T[s<0][:,[0,2,1,5,4,3]]
    u=np.unique(T); m=-np.ones(len(X),int); m[u]=np.arange(len(u))
    return X[u].copy(),m[T]
def hemi_mesh(hmax=.02,g=.12,hr=2e-6,R=1.0,th=.2):
    rim=[(R*np.sin(th),R*np.cos(th)),(R,0.)]
    def build(m):
        o=m.addPoint(0,0,0);p=m.addPoint(R,0,0);q=m.addPoint(R*np.sin(th),R*np.cos(th),0);t=m.addPoint(0,R,0)
        c=[m.addLine(o,p),m.addCircleArc(p,o,q),m.addCircleArc(q,o,t),m.addLine(t,o)]
        m.addPlaneSurface([m.addCurveLoop(c)])
    def h(x,y): return min(hmax,hr+g*np.hypot(x-rim[0][0],y-rim[0][1]),1e-4+g*np.hypot(x-R,y))
    X,T=mesh2d(build,h)
    return X,T
def hemi_sets(X,R=1.,th=.2):
    base=np.where(np.abs(X[:,1])<1e-9)[0]
    on=np.abs(np.hypot(X[:,0],X[:,1])-R)<1e-6
    cap=np.where(on&(np.arctan2(X[:,0],X[:,1])<=th*(1+1e-7)))[0]
    return base,cap
def sample(X,U,T,pts):
    # nearest P2 elements by reference inversion (Newton)
    out=[]
    from scipy.spatial import cKDTree
    cen=X[T].mean(1); tr=cKDTree(cen)
    for p in pts:
        best=None
        for k in tr.query(p,k=60)[1]:
            Xe=X[T[k]]; L=np.array([1/3,1/3])
            for _ in range(12):
                N,dx,de=P2((1-L.sum(),L[0],L[1]))
                Jm=np.stack([dx@Xe,de@Xe],1)
                L=L+np.linalg.solve(Jm,p-N@Xe)
            v=min(L.min(),1-L.sum())
            if best is None or v>best[0]: best=(v,P2((1-L.sum(),L[0],L[1]))[0]@U[T[k]])
            if v>-1e-9: break
        out.append(best[1])
    return np.array(out)
