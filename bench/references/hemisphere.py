from axisymmetric import *
R=.05;E=1e4;d=-.005
def run(nu,mesh,mixed,kind):
    X,T=mesh; base,cap=hemi_sets(X)
    z=X[cap]
    if kind=='axial': n=0; bc=[(base,0,0.),(base,1,0.),(cap,0,0.),(cap,1,d/R)]
    elif kind=='lateral': n=1; bc=[(base,c,0.) for c in range(3)]+[(cap,0,-d/R),(cap,2,d/R),(cap,1,0.)]   # +5 mm in x
    U,Rf,en=solve(X,T,nu,1.,n,bc,mixed)
    if n==0: F=Rf[cap,1].sum()
    else: F=(Rf[cap,0]-Rf[cap,2]).sum()
    return F*E*R*R, X,U,T,Rf,cap
if __name__=='__main__':
    m1=hemi_mesh(); m0=hemi_mesh(hmax=.03,g=.2,hr=1e-5)
    print(len(m1[0]),len(m0[0]))
    ref=json.load(open('../../../shared/reference/hemisphere_patch.json'))
    out={'radius':R,'young':E,'patch_polar_angle':.2,'displacement':[0,0,d],'poisson':{}, 'lateral':{},
     'units':'N, m; dome: polar angle -> [u_r, u_z]; axis: z/R -> u_z. lateral: cap displaced (+5 mm,0,0): force_x; dome: polar angle -> amplitudes [u_r (cos phi), u_z (cos phi), u_phi (sin phi)]; axis: z/R -> u_x'}
    A=[.25,.3,.4,.5,.7,1.,1.3]; Z=[.8,.6,.4,.2]
    for nu in (-.5,0.,.3,.45,.49,.499,.4999):
        for kind in('axial','lateral'):
            mixed=nu>=.45
            F0=run(nu,m0,mixed,kind)[0]
            F,X,U,T,_,_=run(nu,m1,mixed,kind)
            k='%.4g'%nu
            if nu in(.3,.45): k='%.2f'%nu
            dm=sample(X,U,T,[(np.sin(a),np.cos(a)) for a in A])*R; ax=sample(X,U,T,[(1e-12,z) for z in Z])*R
            if kind=='axial':
                out['poisson'][k]={'force_z':F,'dome':{str(a):list(v[:2]) for a,v in zip(A,dm)},'axis':{str(a):v[1] for a,v in zip(Z,ax)}}
            else: out['lateral'][k]={'force_x':F,'dome':{str(a):list(v) for a,v in zip(A,dm)},'axis':{str(a):v[0] for a,v in zip(Z,ax)}}
            rf=ref['poisson'].get(k,{}).get('force_z') if kind=='axial' else None
            print(kind,nu,mixed,'F',F,'coarse',F0,'ref',rf,(F/rf-1) if rf else '',flush=True)
            if rf:
                print('   dome diff',max(abs(np.array(ref['poisson'][k]['dome'][str(a)])-v[:2]).max() for a,v in zip(A,dm)),'axis',max(abs(ref['poisson'][k]['axis'][str(a)]-v[1]) for a,v in zip(Z,ax)))
    json.dump(out,open('hemisphere.json','w'),indent=1)
